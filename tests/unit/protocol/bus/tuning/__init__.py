"""Tests of protocol.bus.tuning."""
