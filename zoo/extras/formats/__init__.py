"""Formats of recordings that few people have: comma.ai's, toy cars' and SullyChen's layout."""
