"""The paper's figures, tables and claims, a file each; see `experiments/README.md`."""
