"""The robot process: control core, operator requests, missions and telemetry."""
