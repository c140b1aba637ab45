"""Every device met by every fault: what is done, what must come of it, what came.

``table`` says what is expected, ``benches`` builds a simulated device and its driver,
``trial`` runs one cell of the matrix, ``page`` writes the page of the documentation.
"""
