"""One look at the scores: from scored runs and a specification to surface, optimum, intervals, posterior, decision."""
