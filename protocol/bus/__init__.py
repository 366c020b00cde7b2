"""The bus between processes, and the only import of Zenoh."""
