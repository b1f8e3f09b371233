"""What a map of primitives is compared with: densities of direction, and of speed where a method has one."""
