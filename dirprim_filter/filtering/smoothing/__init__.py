"""Where was it? Beliefs corrected by what was measured later: a backward sweep over what a filter kept."""
