"""The operator: client, command line, ground station, recordings and missions."""
