"""Speed against accuracy: sweeps, references and what each setting costs."""
