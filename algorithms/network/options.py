"""Limits of networks; light to import, because the web process plans jobs by them."""

ALL_PAIRS_UP_TO = 8
"""Stations of which every pair is tried; of more, pairs are chosen round by round."""
