"""The command line of benchmarks that make a table of logs."""

import argparse
import json

from dirprim_filter import read_tracks


def print_rows(doc, table, **times):
    """The rows of logs, as JSON; how often, by its name, is an option."""
    ((name, often),) = times.items()
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+")
    parser.add_argument(f"--{name}", type=int, default=often)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    rows = table(read_tracks(given.logs), getattr(given, name))
    print(json.dumps({"rows": rows}, default=float, indent=None if given.json else 1))
