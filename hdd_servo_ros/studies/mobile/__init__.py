"""The drive in mobile use: vibration and shock, and what feedforward from accelerometers does against them."""
