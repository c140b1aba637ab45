"""Private parts of the Universal Robots driver.

``worker`` and ``robot`` run in a process of their own, because the client library can
take its process down; everything else runs beside the rest of the product.
"""
