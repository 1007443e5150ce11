"""A world of drivezoo for the programs of LeRobot."""
