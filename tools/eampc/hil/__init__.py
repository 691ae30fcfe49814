"""One closed-loop run of eampcd against the plant emulator, judged and shown: `eampc hil`, `eampc
demo`.
"""
