"""The numbers of arXiv 2411.13140 computed again, with a verdict on every claim.

The paper is "Robust Convergency Indicator using MIMO-PI Controller in the presence of
disturbances". ``parameters`` has its printed numbers, ``study`` computes, ``claims`` judges, and
`flighttune.outputs.paper` draws.
"""
