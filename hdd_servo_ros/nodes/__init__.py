"""One thin file a node: topics and parameters in, one block's step, topics out."""
