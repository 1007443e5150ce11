"""The checks of `drivezoo doctor`.

They must run where packages are missing or Python is too old: at module level they import only the
standard library and each other, and their annotations are not evaluated.
"""
