"""Screen: maps, beliefs and forecasts in rerun and matplotlib. The only package that imports either."""
