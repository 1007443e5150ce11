"""The write-up of a run: what it says, block by block, and how that becomes a page and Markdown."""
