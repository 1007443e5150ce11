"""Saliency: the pixels that move a network's steering; `python -m zoo.saliency` draws them."""
