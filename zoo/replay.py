"""`drivezoo replay`: score a checkpoint on any recording."""

from zoo.evaluate.__main__ import replay

if __name__ == "__main__":
    replay.run()
