"""Learning algorithms on PyTorch: one trust-region core, one file per algorithm.

A new on-policy algorithm is one file: a frozen config, a `Method` (how one batch improves the policy) and
`algorithm = OnPolicyAlgorithm(...)`; plus one entry-point line in group `guard.algorithms`.
"""
