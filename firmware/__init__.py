"""The control core as firmware of an emulated Cortex-M3, and the host's side of its serial link."""
