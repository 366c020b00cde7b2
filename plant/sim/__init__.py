"""The simulation, one control period at a time, without a bus."""
