"""The paper's experiments and claims, and the project's own targets."""
