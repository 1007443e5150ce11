"""The ranking of all runs, in the terminal and on a page: `python -m zoo.leaderboard`."""
