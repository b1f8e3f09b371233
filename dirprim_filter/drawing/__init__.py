"""What rerun, Foxglove and figures draw alike: shapes, colours and names, as plain arrays and texts."""
