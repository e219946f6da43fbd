"""Machine code by LLVM, from text to functions that run."""
