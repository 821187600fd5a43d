"""The geometrical knowledge base of [LeeHuang1985] section 3: object trees, the workcell, and task commands.

It holds plain values and pure functions, and knows no files.
"""
