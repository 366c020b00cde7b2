"""The full-screen ground station. Textual is imported when a screen is opened, not before."""
