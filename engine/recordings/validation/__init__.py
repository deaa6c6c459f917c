"""Why a model misses its measurement: one file = one suspicion, each answered by the error that would be left without it."""
