"""What do vehicles do here? Directional primitives and how they are learned."""
