"""Schema versions of the campaign's data base; run by :mod:`seqrsm.store.database`, never by hand."""
