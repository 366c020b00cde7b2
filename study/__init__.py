"""Trials, studies over many worlds, their report, and calibration."""
