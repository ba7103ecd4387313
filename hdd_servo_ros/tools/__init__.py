"""Commands around recorded and running experiments: rerun, mend, watch."""
