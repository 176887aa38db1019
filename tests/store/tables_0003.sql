-- Tables of version 0003. What it makes has the same names, order, nulls, keys and kinds of columns.
CREATE TABLE files (
    id INTEGER NOT NULL,
    name TEXT NOT NULL,
    sha256 VARCHAR(64) NOT NULL,
    row_count INTEGER NOT NULL,
    ingested_at VARCHAR(32) NOT NULL,
    PRIMARY KEY (id),
    UNIQUE (sha256)
);

CREATE TABLE looks (
    id INTEGER NOT NULL,
    after_run INTEGER NOT NULL,
    application VARCHAR(128) NOT NULL,
    summary JSON NOT NULL,
    looked_at VARCHAR(32) NOT NULL,
    PRIMARY KEY (id)
);

CREATE TABLE meta (
    "key" VARCHAR(64) NOT NULL,
    value TEXT NOT NULL,
    PRIMARY KEY ("key")
);

CREATE TABLE runs (
    id INTEGER NOT NULL,
    batch INTEGER NOT NULL,
    purpose VARCHAR(64) NOT NULL,
    why TEXT NOT NULL,
    source VARCHAR(16) NOT NULL,
    state VARCHAR(16) NOT NULL,
    proposed JSON NOT NULL,
    executed JSON,
    block TEXT NOT NULL,
    cost DOUBLE NOT NULL,
    reason TEXT NOT NULL,
    attempts INTEGER NOT NULL,
    owner TEXT NOT NULL,
    replaces INTEGER,
    proposed_at VARCHAR(32) NOT NULL,
    issued_at VARCHAR(32),
    started_at VARCHAR(32),
    ended_at VARCHAR(32),
    seen_at VARCHAR(32),
    fault VARCHAR(16) DEFAULT '' NOT NULL,
    PRIMARY KEY (id),
    CHECK (id >= 1),
    FOREIGN KEY(replaces) REFERENCES runs (id)
);

CREATE INDEX ix_runs_state ON runs (state);

CREATE TABLE events (
    id INTEGER NOT NULL,
    at VARCHAR(32) NOT NULL,
    version VARCHAR(32) NOT NULL,
    seed BIGINT,
    run_id INTEGER,
    kind VARCHAR(64) NOT NULL,
    detail JSON NOT NULL,
    hash VARCHAR(64) DEFAULT '' NOT NULL,
    PRIMARY KEY (id),
    FOREIGN KEY(run_id) REFERENCES runs (id)
);

CREATE TABLE rankings (
    id INTEGER NOT NULL,
    ranking INTEGER NOT NULL,
    run_id INTEGER NOT NULL,
    application VARCHAR(128) NOT NULL,
    interpreter TEXT NOT NULL,
    session TEXT NOT NULL,
    rank DOUBLE NOT NULL,
    metadata JSON NOT NULL,
    source_file TEXT NOT NULL,
    source_row INTEGER,
    reason TEXT NOT NULL,
    ranked_at VARCHAR(32) NOT NULL,
    PRIMARY KEY (id),
    UNIQUE (ranking, run_id),
    FOREIGN KEY(run_id) REFERENCES runs (id)
);

CREATE TABLE scores (
    id INTEGER NOT NULL,
    run_id INTEGER NOT NULL,
    application VARCHAR(128) NOT NULL,
    score DOUBLE NOT NULL,
    se DOUBLE,
    n INTEGER,
    correct INTEGER,
    metadata JSON NOT NULL,
    source_file TEXT NOT NULL,
    source_row INTEGER,
    scored_at VARCHAR(32) NOT NULL,
    PRIMARY KEY (id),
    UNIQUE (run_id, application),
    FOREIGN KEY(run_id) REFERENCES runs (id)
);
