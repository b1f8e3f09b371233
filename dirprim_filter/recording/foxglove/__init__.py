"""What Foxglove draws: beliefs, particles, forecasts and maps, and the layout of its window.

Source: the Foxglove schemas, https://docs.foxglove.dev/docs/sdk/schemas. Every sub-message is set, zeros too:
a reader that turns messages into columns takes an unset one for a null.
"""
