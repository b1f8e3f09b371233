"""`python -m dirprim_filter` is `dirprim`."""

from dirprim_filter.cli.main import main

main()
