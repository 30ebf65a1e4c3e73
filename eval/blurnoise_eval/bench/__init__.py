"""Benches of this machine: contests of methods, time beside error, one table and one chart each."""
