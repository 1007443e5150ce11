"""A page on which users look at a recording and clean it: `drivezoo edit`."""
