"""The field's metrics of tracking: each file has one, a function of a `Comparison`, which is made once for all."""
