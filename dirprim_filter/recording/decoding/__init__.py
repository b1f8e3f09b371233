"""Messages in protobuf, CDR and JSON to columns of wanted fields, by the definitions that a log carries."""
