"""The public name of the scan: every readable message of an MCAP log, and what could not be read."""

from dirprim_filter.recording.container.log import Scan

scan = Scan
__all__ = ["Scan", "scan"]
