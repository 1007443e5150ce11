"""Ranking of all runs, in the terminal and as an HTML page: `python -m zoo.leaderboard`."""
