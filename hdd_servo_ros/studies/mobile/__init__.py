"""Drive in mobile use: vibration and shock, and the effect of feedforward from accelerometers."""
