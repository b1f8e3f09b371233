"""Hands: parse, build, call; and the one place that turns errors into one line."""
