"""Sensors: the parameters of RSL TR 380-1 Table 1 and what follows from them before any scene is looked at."""
