"""The numbers of arXiv 2411.13140 again, with a verdict on every claim.

The paper is "Robust Convergency Indicator using MIMO-PI Controller in the presence of
disturbances". ``parameters`` holds the numbers that it prints, ``study`` computes and ``claims``
judge; `flighttune.outputs.paper` draws.
"""
