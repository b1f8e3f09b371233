"""How good? Scores of estimates against the truth.

An experiment deals folds (`splits`), fits methods to the training part (rivals by `settings`), gives each case of the
rest a score, and compares methods by pairs over vehicles or groups (`intervals`). `density`, `forecasting`, `cues` and
`tracking` are four: each has its cases, methods, table and conclusion. `scores` judges what any tracker wrote, by
`metrics`, at the instants of `truth`. `calibration` measures a sensor; `baselines` are published rivals.
"""
