"""The files of a run, with typed readers and writers.

Readers limit size and depth, check each field, and report an error in one line. Only these modules
import pydantic, which is slow; other code imports them in the functions that read a file.
"""
