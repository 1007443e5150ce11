"""What a run leaves on disk, and the typed readers of what is read back.

Readers limit size and depth, check field by field, and report what is wrong in one line. pydantic
is imported by these modules alone, and these where a file is read.
"""
