"""Where frames are in each other over time, and satellite positions on a plane."""
