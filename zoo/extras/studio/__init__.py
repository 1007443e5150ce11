"""`drivezoo studio`: one page to drive, record, train and watch."""
