"""Commands for recorded and running experiments: replay, repair, live view."""
