"""Schema versions of the campaign's data base; run by :mod:`seqrsm.campaign.store_connection`, never by hand."""
