"""The bus between processes; only this package imports Zenoh."""
