"""The MCAP container: records, chunks, the Summary section, recovery and writing; it knows nothing of vehicles."""
