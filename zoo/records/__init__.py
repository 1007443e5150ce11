"""What is read back from disk: limited in size and depth, checked field by field, one line if not.

pydantic is imported by these modules alone, and these where a file is read.
"""
