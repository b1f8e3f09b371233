"""What a map of primitives is compared with: densities of direction, and forecasts."""
