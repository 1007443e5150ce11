"""Input of ill will or bad luck: real files and processes."""
