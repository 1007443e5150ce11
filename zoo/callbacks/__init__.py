"""Lightning callbacks: one file and one YAML in `conf/callbacks` each."""
