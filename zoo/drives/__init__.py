"""The record of a drive, its metrics and films, speed controllers and the steering filter."""
