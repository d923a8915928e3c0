"""Computing processes: started, confined, limited, heard."""
