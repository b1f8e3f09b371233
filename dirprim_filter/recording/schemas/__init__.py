"""Which schemas of a log can be read as observed objects, and by what."""

ESTIMATES_SCHEMA = "dirprim.TrackEstimates"
"""The schema of our own estimates: no observations, so no input."""
