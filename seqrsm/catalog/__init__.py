"""Tables A.1 to A.39 of RSL TR 380-1 as data: what the literature asks of a microwave sensor, and what carries it.

Tables A.1 to A.20 tell which applications ask for which resolution, band, polarization, angle and revisit; A.21 to A.39
describe platforms. Everything is kept as printed, contradictions too, with the number of its table; the numbers read
from the print stand beside it. `load_catalog` reads the files once; nothing heavy is imported.
"""
