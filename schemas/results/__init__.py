"""Result documents of jobs and their parts."""
