"""Saliency: the pixels that move a network's steering; `drivezoo saliency` draws them."""
