"""Screen: maps, beliefs and forecasts in rerun and matplotlib. The only room that imports either."""
