"""Limits of networks; light to import, because the web process plans jobs by them."""

ALL_PAIRS_UP_TO = 8
"""Stations of which every pair is tried; of more, pairs are chosen round by round."""

MOST_TIED = 500
"""Stations that are adjusted with targets, control or errors of instruments at most: there their poses have one dense
covariance, whose memory grows with the square of their number and its factorisation with the third power."""
