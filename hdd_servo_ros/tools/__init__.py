"""Commands around recorded and running experiments: rerun, repair, watch."""
