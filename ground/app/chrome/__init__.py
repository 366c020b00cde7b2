"""Contain what surrounds the content of every screen: tabs, answers and keys."""
