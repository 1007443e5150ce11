"""Exchange of recordings with LeRobotDataset v3 and Donkeycar's tubs."""
