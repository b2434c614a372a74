"""A page on one's own machine for trying settings and watching jobs: `rsvideo view`.

The server decodes nothing and computes nothing itself: clips are opened, previewed and calibrated in processes of their own, each with
a limit of time. It keeps nothing that is not also on the disk: jobs are processes that outlive it, and their status stands beside their
ledgers.
"""
