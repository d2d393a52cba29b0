"""Figures of a reproduction (`command.reproduce`) and of the demo; of the documentation: `cost`, `blind_trial`."""
