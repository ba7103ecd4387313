"""Commands for recorded and running experiments: report, replay, repair and scope."""
