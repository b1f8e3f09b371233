"""Which schemas of a log can be read as observed objects, and by what."""

ESTIMATES_SCHEMA, ASSIGNMENTS_SCHEMA = "dirprim.TrackEstimates", "dirprim.Assignments"
"""Of what a tracker writes: no observations, so no input."""
