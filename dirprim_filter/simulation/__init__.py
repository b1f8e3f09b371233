"""Traffic: Eclipse SUMO (the optional extra `sim`) drives this project's own scenes, and a sensor watches."""
