"""How does a sensor err? Its detections beside the truth."""
