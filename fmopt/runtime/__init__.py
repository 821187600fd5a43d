"""The program as a process: compiled kernels, time limits, children, signals, files it writes, text it escapes."""
