"""The objects that the messages of a log report, as detections and as tracks."""
