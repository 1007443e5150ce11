"""Networks and weights of other frameworks: Keras files, and public ImageNet weights."""
