"""What a network looks at; `python -m zoo.saliency` draws it."""
