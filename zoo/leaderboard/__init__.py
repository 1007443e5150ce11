"""Ranking of all runs, in the terminal and as an HTML page: `drivezoo leaderboard`."""
