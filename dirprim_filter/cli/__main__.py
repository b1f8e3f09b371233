"""`python -m dirprim_filter.cli` is `dirprim`."""

from dirprim_filter.cli.main import main

main()
