"""Do simulated frames behave like real ones? Measures of both, verdicts, and a classifier that tells them apart."""
