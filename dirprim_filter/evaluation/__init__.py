"""How good? Scores of estimates against the truth."""
