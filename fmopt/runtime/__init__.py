"""The program as a process: compiled kernels, time limits, children, signals, files that it writes, text that it escapes."""
