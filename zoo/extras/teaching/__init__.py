"""`drivezoo grade`: drive what a class submits, on roads of the teacher's own."""
