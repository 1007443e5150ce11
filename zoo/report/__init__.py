"""The report of a run: sections of blocks, and their output as HTML and Markdown."""
