-- Tables as the first version made them (schema 0001).
CREATE TABLE alembic_version (
    version_num VARCHAR(32) NOT NULL,
    CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO alembic_version VALUES('0001');
CREATE TABLE meta (
    "key" VARCHAR(64) NOT NULL,
    value TEXT NOT NULL,
    CONSTRAINT pk_meta PRIMARY KEY ("key")
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
    CONSTRAINT pk_runs PRIMARY KEY (id),
    CONSTRAINT ck_runs_id CHECK (id >= 1),
    CONSTRAINT fk_runs_replaces FOREIGN KEY(replaces) REFERENCES runs (id)
);
CREATE INDEX ix_runs_state ON runs (state);
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
    CONSTRAINT pk_scores PRIMARY KEY (id),
    CONSTRAINT fk_scores_run_id FOREIGN KEY(run_id) REFERENCES runs (id),
    CONSTRAINT uq_scores_run_id UNIQUE (run_id, application)
);
CREATE TABLE looks (
    id INTEGER NOT NULL,
    after_run INTEGER NOT NULL,
    application VARCHAR(128) NOT NULL,
    summary JSON NOT NULL,
    looked_at VARCHAR(32) NOT NULL,
    CONSTRAINT pk_looks PRIMARY KEY (id)
);
CREATE TABLE events (
    id INTEGER NOT NULL,
    at VARCHAR(32) NOT NULL,
    version VARCHAR(32) NOT NULL,
    seed BIGINT,
    run_id INTEGER,
    kind VARCHAR(64) NOT NULL,
    detail JSON NOT NULL,
    CONSTRAINT pk_events PRIMARY KEY (id),
    CONSTRAINT fk_events_run_id FOREIGN KEY(run_id) REFERENCES runs (id)
);
CREATE TABLE files (
    id INTEGER NOT NULL,
    name TEXT NOT NULL,
    sha256 VARCHAR(64) NOT NULL,
    row_count INTEGER NOT NULL,
    ingested_at VARCHAR(32) NOT NULL,
    CONSTRAINT pk_files PRIMARY KEY (id),
    CONSTRAINT uq_files_sha256 UNIQUE (sha256)
);
