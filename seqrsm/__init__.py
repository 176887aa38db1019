"""Sequential response-surface campaigns that find the best design of a microwave remote sensor.

The tree reads like the method of RSL TR 380-1: ``scene`` and ``scattering`` and ``sensor`` feed ``simulate``, whose
images ``score`` turns into utilities; ``design`` and ``fit`` describe the response surface; ``propose`` and ``decide``
choose the next runs and say when to stop; ``campaign`` joins the two sides; ``report`` and ``cli`` show the result.
"""

__version__ = "0.1.0"
