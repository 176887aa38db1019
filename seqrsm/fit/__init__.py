"""Estimation: least squares, the exact conjugate posterior, ensemble sampling, diagnostics and the optimum."""
