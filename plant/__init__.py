"""The simulated robots and their world: worlds, simulation, and the plant process."""
